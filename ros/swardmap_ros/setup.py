"""The ROS 2 package: executables and a launch file; what they run is the Python package `swardmap`."""

from setuptools import setup

NAME = "swardmap_ros"

setup(
    name=NAME,
    version="0.1.0",
    description="From RGB-D cameras to an obstacle map for Nav2: starts the node of the package swardmap.",
    license="Apache-2.0",
    packages=[],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/swardmap.launch.py"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    entry_points={
        "console_scripts": ["swardmap = swardmap.ros.run:main", "gate = swardmap.ros.gate_node:main"]
    },
)
