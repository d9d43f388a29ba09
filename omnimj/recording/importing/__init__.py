"""Logs of other programs as datasets: what was understood, a mapping to edit, and the conversion.

- `tables`: files as named columns; `dialect` and `csv_table` for CSV, `nested` for JSON and MATLAB
- `units`: units that loggers write, and their SI units
- `mapping`: the mapping file, read and written
- `propose`: a mapping guessed from names, units and values
- `apply`: a mapping applied to a table
- `quality`: rate, regularity, packets, and whether wheels and measured pose agree
- `workflow`: the import of many files
"""
