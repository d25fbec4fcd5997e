"""Study of the filter for a continuum; truths are soft bodies of finite elements."""
