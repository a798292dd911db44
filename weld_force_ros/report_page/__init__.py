"""The report: one self-contained page of welds, from a recording or force maps (extra: report).

`row` and `detail` make of a weld what the page shows of it, `page` the page around them: with rows and details inside,
or for a server that hands them out as they come.
"""

from weld_force_ros.report_page.details import detail
from weld_force_ros.report_page.document import page
from weld_force_ros.report_page.rows import row
from weld_force_ros.report_page.welds import Entry, Unusable, Weld

__all__ = ["Entry", "Unusable", "Weld", "detail", "page", "row"]
