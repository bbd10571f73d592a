"""Hydra's launcher ``ray``: every row of a sweep is a task of Ray, and one that is lost does not end the others."""

from __future__ import annotations

import re
import socket
from collections.abc import Sequence
from contextlib import suppress
from typing import Any
from unittest.mock import patch

from hydra.core.utils import JobReturn, JobStatus

with suppress(ImportError):  # without the extra `ray` nothing is here, and hydra/launcher=ray is refused
    from hydra_plugins.hydra_ray_launcher.ray_launcher import RayLauncher as PluginLauncher

    class RayLauncher(PluginLauncher):
        """The plug-in's launcher, but for rows that are lost."""

        def launch(self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int) -> Sequence[JobReturn]:
            """Run the rows; one that is lost, however often Ray tried it, returns nothing: it stays unfinished.

            Raises:
                BadInput: no Ray can be started, or none answers at the address.
            """
            import ray
            from ray.exceptions import RayError

            from sci_lightning.errors import BadInput

            wait, address = ray.get, self.ray_cfg.init.address

            def result_or_lost(row: Any) -> JobReturn:
                try:
                    result: JobReturn = wait(row)
                except RayError:
                    return JobReturn(status=JobStatus.COMPLETED)
                result.cfg = result.hydra_cfg = None  # nobody reads them from there
                return result

            try:
                if place := re.fullmatch(r"([^:/]+):(\d+)", address or ""):  # which Ray would try for minutes
                    socket.create_connection((place[1], int(place[2])), timeout=10).close()
                with patch.object(ray, "get", result_or_lost):
                    results: Sequence[JobReturn] = super().launch(job_overrides, initial_job_idx)
            except (OSError, RuntimeError, ValueError) as error:
                raise BadInput(
                    f"hydra.launcher.ray.init.address={address}: {' '.join(str(error).split())}; give the address that "
                    "`ray start --head` printed, or null for a Ray of this machine"
                ) from error
            return results
