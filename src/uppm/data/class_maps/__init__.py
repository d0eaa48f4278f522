"""Labels of data sets and the unified categories that are right for them (docs/evaluation.md)."""
