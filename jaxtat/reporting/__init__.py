"""A page about one reconstruction, for people: figures, numbers in words, and where it is from."""

from .scan import report_file, report_scan
from .writing import report, write_report

__all__ = ["report", "report_file", "report_scan", "write_report"]
