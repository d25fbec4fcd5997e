"""Whether the filter's covariance is right however coarse the marks are; `__main__` has the command."""
