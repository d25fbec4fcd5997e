"""Soft bodies of elements as truths of the filter of a continuum."""
