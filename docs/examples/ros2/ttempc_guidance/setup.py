from setuptools import setup

PACKAGE = "ttempc_guidance"

setup(
    name=PACKAGE,
    version="0.2.0",
    packages=[PACKAGE],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/config", ["config/guidance.yaml"]),
        (f"share/{PACKAGE}/launch", ["launch/guidance.launch.py"]),
    ],
    install_requires=["setuptools", "ttempc"],
    entry_points={"console_scripts": [f"guidance_node = {PACKAGE}.guidance_node:main"]},
)
