"""Readers of ground truth, a format a file; `ground_truth.TruthReader` says what each offers."""
