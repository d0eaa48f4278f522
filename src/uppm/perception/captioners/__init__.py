"""Networks that say what is in a picture, each a `Captioner` in a file of its own, and the parts that they share."""
