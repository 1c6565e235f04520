"""Tag of a wheel that holds machine code: `make wheel` puts the library into the checkout, this names its platform."""

from __future__ import annotations

import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class PlatformTag(BuildHookInterface):
    """Tag as py3-none-PLATFORM: the library depends on the processor, not on Python's version."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Set the tag if there is a library."""
        if version == "standard" and any(Path(self.root, "edc_swarm", "planner").glob("kernels-*.so")):
            platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
            build_data["pure_python"], build_data["tag"] = False, f"py3-none-{platform}"
