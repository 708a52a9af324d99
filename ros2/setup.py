from setuptools import setup

NAME = "mirrorcam_ros"

setup(
    name=NAME,
    version="0.2.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/mirrorcam.launch.py"]),
    ],
    install_requires=["setuptools", "mirrorcam"],
    zip_safe=True,
    maintainer="MirrorCam maintainers",
    maintainer_email="maintainers@mirrorcam.invalid",
    description="Publishes the light field of a MirrorCam: rectified views, depth and points",
    license="Apache-2.0",
    entry_points={"console_scripts": [f"light_field = {NAME}.node:main"]},
)
