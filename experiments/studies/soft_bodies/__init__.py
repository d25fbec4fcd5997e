"""Study of the filter of a continuum with soft bodies of elements as truths."""
