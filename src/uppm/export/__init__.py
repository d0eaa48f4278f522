"""Meshes, pictures and scene descriptions as files of other programs. Imports `core` only."""
