"""Campaigns: the welds of a whole network on Dask, from files, tables and bags to Parquet, Zarr and a page.

`definition` reads the campaign's file, `sources` finds its welds and cuts them into batches, `plan` says what is to be
done and how long it will take, `work` is the task that assesses a batch, `store` holds the results, `records` what is
finished, `run` is all of it; `query` and `summary` look at the results (extra: campaign).
"""
