"""Assess the welds of a whole network on Dask, from files, tables and bags to Parquet, Zarr and a page.

`campaign_file` reads the campaign's file, `sources` finds its welds and divides them into batches, `plan` fixes what is
to be done and `estimate` how long it takes, `batch_task` assesses a batch, `result_store` holds the results,
`batch_records` what is finished, `dask_run` is all of it; `query` and `summary` evaluate the results (extra: campaign).
"""
