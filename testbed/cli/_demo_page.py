"""The page that `testbed demo` ends with: the report's page, in its look, with the demo's pictures put into the file."""

from __future__ import annotations

from testbed.analysis.report.page import Page

__all__ = ["Page"]
