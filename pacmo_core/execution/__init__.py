"""Work side by side: processes on this machine, or a Dask cluster."""
