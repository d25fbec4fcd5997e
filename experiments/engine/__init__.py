"""Runs of studies, on this machine or a cluster, stored as they finish.

Distribution and storage of runs belong here.
"""

# Dask and pyarrow, the extra `cluster`, are imported where they are used: runs in this process need neither.
