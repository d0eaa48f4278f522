"""Unified promptable panoptic mapping."""
