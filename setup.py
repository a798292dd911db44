"""What pyproject.toml cannot say: the package's share in a ROS installation, and commands that only colcon installs."""

import sys
from glob import glob

from setuptools import Distribution, setup

NAME = "weld_force_ros"
NODES = ("profile_node", "simulator_node", "assessment_node", "trolley_node", "dashboard_node", "foxglove_node")


class DataInEditable(Distribution):
    """Setuptools leaves data files out of an editable install unless the distribution answers to this name."""

    def has_data(self) -> bool:
        """Whether there are data files."""
        return bool(self.has_data_files())


commands = ["weld-force = weld_force_ros.cli.main:main"]
# colcon asks for one of these; pip builds a wheel, whose commands would all lie on the user's path.
if {"install", "develop"} & set(sys.argv):
    commands += [f"{node} = weld_force_ros.ros.launcher:{node}" for node in NODES]

setup(
    # These two in pyproject.toml would stop colcon: the setuptools of Ubuntu 24.04 takes no license as text, and colcon
    # cannot read what setuptools makes of requires-python.
    license="MIT",
    python_requires=">=3.11,<3.14",
    entry_points={"console_scripts": commands},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        # `colcon build --symlink-install` builds in a folder with links to just these, and needs pyproject.toml there.
        (f"share/{NAME}", ["package.xml", "pyproject.toml", "README.md"]),
        (f"share/{NAME}/launch", glob("launch/*.launch.py")),
        (f"share/{NAME}/config", glob(f"{NAME}/data/config/*.yaml")),
    ],
    distclass=DataInEditable,
)
