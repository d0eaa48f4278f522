"""Benchmarks that work where the package is installed; each composes what it measures (docs/performance.md)."""
