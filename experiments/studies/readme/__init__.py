"""The figures and pictures of the README."""
