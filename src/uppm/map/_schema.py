"""The map file's tables; docs/map-file.md says what each column means."""

from __future__ import annotations

APPLICATION_ID = 0x5550504D
"""'UPPM' in SQLite's header: tells a map from any other SQLite file."""
SCHEMA_VERSION = 1
"""Raised when an older reader could not read the file."""
PAGE_SIZE = 16384

TABLES = """
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE categories (
    id INTEGER PRIMARY KEY, name TEXT NOT NULL, supercategory TEXT NOT NULL,
    is_thing INTEGER NOT NULL, voxel_size REAL NOT NULL);
CREATE TABLE submaps (
    id INTEGER PRIMARY KEY, kind TEXT NOT NULL, state TEXT NOT NULL,
    category INTEGER REFERENCES categories (id), confidence REAL,
    voxel_size REAL NOT NULL, truncation REAL NOT NULL, T_map_submap BLOB NOT NULL,
    first_frame INTEGER NOT NULL, last_frame INTEGER NOT NULL,
    views INTEGER NOT NULL, misses INTEGER NOT NULL, evidence REAL NOT NULL, companions TEXT NOT NULL,
    min_x REAL, min_y REAL, min_z REAL, max_x REAL, max_y REAL, max_z REAL);
CREATE TABLE labels (
    submap INTEGER NOT NULL REFERENCES submaps (id) ON DELETE CASCADE, position INTEGER NOT NULL,
    text TEXT NOT NULL, category INTEGER NOT NULL, count INTEGER NOT NULL, weight REAL NOT NULL,
    provenance TEXT NOT NULL, first_frame INTEGER NOT NULL, last_frame INTEGER NOT NULL,
    PRIMARY KEY (submap, position)) WITHOUT ROWID;
CREATE TABLE label_embeddings (text TEXT PRIMARY KEY, vector BLOB NOT NULL) WITHOUT ROWID;
CREATE TABLE blocks (
    submap INTEGER NOT NULL REFERENCES submaps (id) ON DELETE CASCADE,
    x INTEGER NOT NULL, y INTEGER NOT NULL, z INTEGER NOT NULL, voxels BLOB NOT NULL,
    PRIMARY KEY (submap, x, y, z)) WITHOUT ROWID;
CREATE TABLE frames (idx INTEGER PRIMARY KEY, stamp REAL, T_map_camera BLOB, skipped TEXT);
CREATE TABLE report (
    section TEXT NOT NULL, reason TEXT NOT NULL, value REAL NOT NULL, PRIMARY KEY (section, reason)) WITHOUT ROWID;
"""

# Not among `TABLES`: only a map that was compared with an older one has it.
CHANGES = """
CREATE TABLE IF NOT EXISTS changes (
    position INTEGER PRIMARY KEY, state TEXT NOT NULL, id_old INTEGER, id_new INTEGER,
    category TEXT NOT NULL, label TEXT NOT NULL,
    old_x REAL, old_y REAL, old_z REAL, new_x REAL, new_y REAL, new_z REAL, evidence TEXT NOT NULL)
"""

# Not among `TABLES`: maps of before submaps were split have none.
PARTS = """
CREATE TABLE IF NOT EXISTS parts (
    submap INTEGER PRIMARY KEY REFERENCES submaps (id) ON DELETE CASCADE, frames INTEGER NOT NULL, cells BLOB NOT NULL)
"""

# As `CHANGES`: only a map that was edited has them.
CORRECTIONS = """
CREATE TABLE IF NOT EXISTS corrections (
    number INTEGER PRIMARY KEY, edit INTEGER NOT NULL, stamp TEXT NOT NULL, author TEXT NOT NULL, action TEXT NOT NULL,
    submap INTEGER NOT NULL, name TEXT, category TEXT, other INTEGER, before TEXT NOT NULL, undone TEXT)
"""
SUCCESSORS = "CREATE TABLE IF NOT EXISTS successors (submap INTEGER PRIMARY KEY, kept INTEGER NOT NULL)"

# As `CHANGES`: only a map made with `perception.visual_feature` has it.
VISUAL_FEATURES = """
CREATE TABLE IF NOT EXISTS visual_features (
    submap INTEGER PRIMARY KEY REFERENCES submaps (id) ON DELETE CASCADE, count INTEGER NOT NULL, vector BLOB NOT NULL)
"""
