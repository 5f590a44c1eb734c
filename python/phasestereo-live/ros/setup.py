"""The package for ROS 2, as ament_python builds it."""

from setuptools import setup

NAME = "phasestereo_ros"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/phasestereo.launch.py"]),
    ],
    install_requires=["setuptools", "phasestereo[live,rectify]"],
    zip_safe=True,
    description="Dense stereo matching in the place of stereo_image_proc",
    license="Apache-2.0",
    entry_points={"console_scripts": [f"phasestereo_node = {NAME}.node:main"]},
)
