"""Study of the filter for a continuum on simulated soft bodies of finite elements."""
