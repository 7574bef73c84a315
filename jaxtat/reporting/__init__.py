"""A page about one reconstruction, for people: figures, numbers in words, and where it is from."""

from .report import report, write_report
from .scan import report_file, report_scan

__all__ = ["report", "report_file", "report_scan", "write_report"]
