"""Run files: one append-only MCAP file per release, with readers, checks, exports and imports.

sidecar     the .sha256 file of a finished run
metadata    origin and end of a run
layout      channels, schemas, records and limits of the file
writer      RunWriter: writes samples to disk as they arrive
scan        records of a file up to the first damaged record
reader      load_run: reads a file as a Run
inspect     info, verify, recover
export      EXPORTERS: .csv, .parquet, .h5, .mat, JointState in .mcap
tables      a text table of any logger: its columns, their meaning and plausibility, a preview
readers     READERS: reads files of other formats as such a table
csv_import  import_csv: converts a table to a run
spool       temporary file of a recording, check of the disk space
viewers     VIEWERS: layouts of Foxglove and PlotJuggler for run files
"""
