"""Limits that tests judge by where another thing than a rule book is their subject."""

from pathlib import Path

from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.messages import AssessmentSettings

OF_1_3 = Path(__file__).parents[1] / "data" / "limits-1.3.yaml"


def by_value() -> AssessmentSettings:
    """The limits of contract 1.1 to 1.3: values are compared with them, and geometry is informative."""
    return load_limits(OF_1_3)
