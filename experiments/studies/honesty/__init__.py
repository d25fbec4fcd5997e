"""Test of the filter's covariance for marks with any noise level; `__main__` has the command."""
