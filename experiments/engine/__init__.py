"""Runs of studies on this machine or a cluster, and storage of their results."""

# Dask and pyarrow, the extra `cluster`, are imported where they are used: runs in this process need neither.
