"""Distribution and storage of the runs of studies, on this machine or a cluster."""

# Dask and pyarrow, the extra `cluster`, are imported where they are used: runs in this process need neither.
