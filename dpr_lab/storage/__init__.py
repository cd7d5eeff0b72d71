"""Runs on disk: one append-only MCAP file per release, its reader, checks, exports and the table importer.

sidecar     the .sha256 file of a finished run
metadata    origin and end of a run
layout      channels, schemas, records and limits of the file
writer      RunWriter: samples to disk as they arrive
scan        a file's records up to its first damage
reader      load_run: a file as a Run
inspect     info, verify, recover
export      EXPORTERS: .csv, .parquet, .h5, .mat, JointState in .mcap
table       a text table of any logger as columns
readers     READERS: files of other formats as such a table
columns     meaning of the columns
csv_import  import_csv: a table as a run
preview     interpretation of a table
"""
