"""Traces and datasets, read from and written to files.

- `traces`: `trace.parquet` of one run, one row per control step.
- `dataset`: records of a dataset, and the columns that each plant's runs have.
- `dataset_file`, `read_dataset`, `write_dataset`: a folder of measured runs with its `dataset.toml`.
- `run_table`: tables in CSV and Parquet files; damaged ones are reported with the place of the damage.
- `importing`: logs of other programs as datasets.
- `logger_faults`: readings that a slow logger repeats, and currents without their sign.
- `mask`: gaps in time and single-sample spikes, which must not be fitted.
- `folder`: output folders that are never overwritten by accident, files that are complete or absent.
- `json_files`: results as JSON files.
"""
