from pathlib import Path

from setuptools import setup

PACKAGE = "doorway3ds_ros"


def files(folder):
    return [str(path) for path in sorted(Path(folder).iterdir()) if path.is_file()]


setup(
    name=PACKAGE,
    version="1.0.0rc1",
    packages=[PACKAGE],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/launch", files("launch")),
        (f"share/{PACKAGE}/rviz", files("rviz")),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    maintainer="doorway3ds",
    maintainer_email="doorway3ds@users.noreply.github.com",
    description="Open doorways from one camera: the node of doorway3ds, with launch file and RViz.",
    license="Apache-2.0",
    entry_points={"console_scripts": [f"doorway3ds = {PACKAGE}.node:main"]},
)
