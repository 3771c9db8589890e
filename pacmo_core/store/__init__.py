"""Files: tables and motions in Parquet, weights in safetensors, the cache, atomic writes."""
