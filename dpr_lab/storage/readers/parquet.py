"""Read Apache Parquet files with pyarrow."""

from collections.abc import Sequence
from pathlib import Path

from dpr_lab.storage.export import extra
from dpr_lab.storage.readers.arrays import library_of, refuse_swollen, table_of
from dpr_lab.storage.tables.table import Table

KIND = "Parquet file"


def read_parquet(path: Path, take: Sequence[str]) -> Table:
    """Read every numeric column of a Parquet file; a missing value is NaN.

    Raises:
        RunError: the file is damaged, or contains no numbers or more numbers than a recording can have.
        DprError: pyarrow is not installed.
    """
    with extra("parquet"):
        import pyarrow as pa
        import pyarrow.parquet as pq
    with library_of(path, KIND, pa.ArrowException), pq.ParquetFile(path) as file:
        numeric = [
            field.name
            for field in file.schema_arrow
            if pa.types.is_integer(field.type) or pa.types.is_floating(field.type)
        ]
        refuse_swollen(path, 8 * file.metadata.num_rows * len(numeric))
        read = file.read(columns=numeric, use_threads=False)
        columns = {name: read.column(name).to_numpy() for name in numeric}
    return table_of(path, KIND, columns, take)
