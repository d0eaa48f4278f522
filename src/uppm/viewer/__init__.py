"""Viewers of a map: one self-contained HTML file, and a page served by viser (docs/viewer.md)."""
