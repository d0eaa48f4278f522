"""The regimes of the evaluation, composed of the stages (paper section 4, docs/evaluation.md)."""

from uppm.regimes.reconstructions import map_reconstruction, open_reconstruction

__all__ = ["map_reconstruction", "open_reconstruction"]
