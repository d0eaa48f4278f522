"""Package data: category table, embeddings, detector weights, demo sequence. Licences in NOTICE."""
