"""The regimes of the evaluation, composed of the stages (paper section 4, docs/evaluation.md)."""
