"""Study of the filter for a continuum; the truths are simulated soft bodies of finite elements."""
