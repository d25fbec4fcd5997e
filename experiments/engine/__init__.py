"""Runs of studies, on this machine or a cluster, stored as they finish.

What may enter: distribution and storage of runs.
"""

# Dask and pyarrow, the extra `cluster`, are imported where they are used: runs in the own process need neither.
