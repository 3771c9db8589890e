"""Build the package with the default settings inside: the root params.yaml, its only copy."""

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py


class BuildWithDefaults(build_py):
    """Copy params.yaml into the built package."""

    def run(self) -> None:
        """Build as usual, then copy; an editable install reads the root file itself."""
        super().run()
        if not self.editable_mode:
            target = Path(self.build_lib) / "pacmo_core" / "params.yaml"
            shutil.copyfile(Path(__file__).parent / "params.yaml", target)


setup(cmdclass={"build_py": BuildWithDefaults})
