"""The names of the formats, as ``?format=`` takes them."""

from typing import Literal

FormatName = Literal["json", "ndjson", "csv", "npz", "arrow", "parquet"]
FORMAT_HELP = "The format, whatever the Accept header says."
