"""A real Slurm of one node in a folder: Debian's packages slurm-wlm and munge, as root; it is up within seconds."""

from __future__ import annotations

import os
import secrets
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

CONF = """\
ClusterName=one
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge/munge.socket,cred_expire=5
CryptoType=crypto/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
MpiDefault=none
ReturnToService=2
JobRequeue=1
KillWait=15
MinJobAge=86400
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
SlurmctldPort={controller}
SlurmdPort={node}
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} RealMemory=8000 State=UNKNOWN
PartitionName=cpu Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""
"""``cred_expire`` is also what a job that is queued again waits; ``MinJobAge`` keeps what became of a job."""

SACCT = """\
#!/bin/bash
# without accounting: what submitit asks sacct for, from the controller
echo "JobID|State|NodeList"
scontrol show job -o 2>/dev/null | while read -r line; do
  get() { [[ " $line " =~ \\ $1=([^\\ ]*) ]] && echo "${BASH_REMATCH[1]}"; }
  array=$(get ArrayJobId); task=$(get ArrayTaskId)
  [ -n "$array" ] && [ -n "$task" ] && name="${array}_${task}" || name=$(get JobId)
  echo "$name|$(get JobState)|$(get NodeList)"
done
"""

DAEMONS = ("munged", "slurmctld", "slurmd")


def missing() -> str | None:
    """Return why no Slurm can be started here; None if one can."""
    absent = [program for program in (*DAEMONS, "sbatch", "srun") if shutil.which(program) is None]
    if absent:
        return f"{', '.join(absent)}: not installed (Debian: slurm-wlm, munge)"
    return "munge and Slurm are started as root" if os.geteuid() else None


class OneNodeSlurm:
    """A controller and a node of their own ports; ``start`` and ``stop`` take the name of a daemon.

    Args:
        folder: of configuration, state and logs; made, short enough for a socket's path (100 characters).
        cpus: that the node says it has.

    Attributes:
        environment: in which Slurm's commands reach it.
    """

    def __init__(self, folder: Path, cpus: int = 2) -> None:
        self.folder = folder.absolute()
        for name in ("state", "spool", "munge", "bin"):
            (self.folder / name).mkdir(parents=True)
        key = self.folder / "munge" / "munge.key"
        key.write_bytes(secrets.token_bytes(1024))
        key.chmod(0o400)
        self.folder.chmod(0o755)
        settings = {"host": socket.gethostname(), "folder": self.folder, "cpus": cpus}
        (self.folder / "slurm.conf").write_text(CONF.format(controller=_port(), node=_port(), **settings))
        sacct = self.folder / "bin" / "sacct"
        sacct.write_text(SACCT)
        sacct.chmod(0o755)
        path = f"{self.folder / 'bin'}:{os.environ['PATH']}"
        self.environment = {**os.environ, "SLURM_CONF": str(self.folder / "slurm.conf"), "PATH": path}
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> OneNodeSlurm:
        try:
            for name in DAEMONS:
                self.start(name)
            wait_until(lambda: "idle" in self("sinfo", "--noheader", "--format=%t"), 60, "no node is idle")
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        if "slurmctld" in self._running:
            self("scancel", "--user=root")
            wait_until(lambda: not self("squeue", "--noheader"), 60, "jobs do not end")
        for name in reversed(DAEMONS):
            self.stop(name)

    def __call__(self, *words: str) -> str:
        """Run one of Slurm's commands; return what it prints, whether or not it fails."""
        done = subprocess.run(words, env=self.environment, capture_output=True, text=True, timeout=300)
        return done.stdout + done.stderr

    def start(self, name: str) -> None:
        munge = self.folder / "munge"
        options = {
            "munged": [
                *("--force", "--foreground", f"--socket={munge}/munge.socket", f"--key-file={munge}/munge.key"),
                *(f"--log-file={munge}/log", f"--pid-file={munge}/pid", f"--seed-file={munge}/seed"),
            ],
            "slurmctld": ["-D"],
            "slurmd": ["-D"],
        }[name]
        with (self.folder / f"{name}.out").open("ab") as out:
            self._running[name] = subprocess.Popen([name, *options], env=self.environment, stdout=out, stderr=out)
        if name == "munged":
            wait_until((munge / "munge.socket").exists, 20, "munged does not start")
        if name == "slurmctld":
            wait_until(lambda: "UP" in self("scontrol", "ping"), 30, "slurmctld does not start")

    def stop(self, name: str) -> None:
        if (process := self._running.pop(name, None)) is not None:
            process.send_signal(signal.SIGTERM)
            process.wait(30)

    def jobs(self) -> dict[str, str]:
        """Return the states of all jobs by their numbers, ``{"3_0": "RUNNING"}``."""
        lines = [line.split("|") for line in self("sacct").splitlines()[1:]]
        return {name: state for name, state, _ in lines}


def wait_until(true: Callable[[], object], seconds: float, failure: str) -> None:
    """Wait for something; raises TimeoutError, which says what did not happen."""
    end = time.monotonic() + seconds
    while not true():
        if time.monotonic() > end:
            raise TimeoutError(failure)
        time.sleep(0.1)


def _port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])
