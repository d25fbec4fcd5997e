"""Test of the filter's covariance for marks of any noise; `__main__` has the command."""
