"""The report: a page on one reconstruction, with figures, conclusions and provenance."""

from .scan import report_scan
from .writing import report, write_report

__all__ = ["report", "report_scan", "write_report"]
