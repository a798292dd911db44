"""The demo: the bundled welds on a line of a speed, judged by geometry and force."""

from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.measurement.profile_file import shipped
from weld_force_ros.ros import demo


def test_the_demo_shows_welds_and_no_vehicles_defect():
    assert demo.demo_profiles().keys() == shipped().keys() - {"wheel-flat-0.9mm", *(f"weld-{n}" for n in range(1, 6))}


def test_the_demo_judges_both_questions():
    assert [book.name for book in load_limits(demo.LIMITS).rule_books] == ["force", "banenor-531"]
