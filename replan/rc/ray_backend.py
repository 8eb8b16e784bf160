"""Runs jobs on a Ray cluster: each worker runs the same process an episode, and records come back to the driver.

Needs the extra `cluster` here, and this program on every worker. Folders of runs stay where they were made: on a file
system that all machines share they lie beside the records, otherwise on the workers.
"""

from collections.abc import Iterator, Sequence
from typing import Any

from control.errors import MachineError
from replan.rc.jobs import Job
from replan.rc.records import EpisodeRecord
from replan.rc.runner import Backend, Work
from replan_base.parts import install_part


def ray_backend(ray: Any = None) -> Backend:
    """Runs jobs as Ray tasks of one core each.

    Args:
        ray: The module, connected to a cluster already; None imports it and connects to the cluster that RAY_ADDRESS
            names, or to a new one on this machine.

    Raises:
        MachineError: Ray is not installed.
    """
    if ray is None:
        ray = _connected()

    def run(jobs: Sequence[Job], work: Work) -> Iterator[tuple[Job, EpisodeRecord]]:
        # An episode that failed is a record; a worker that is lost runs its job again on another one.
        remote = ray.remote(num_cpus=1, max_retries=2)(_text_of)
        waiting = {remote.remote(work, job): job for job in jobs}
        try:
            while waiting:
                (ready, *_), _ = ray.wait(list(waiting), num_returns=1)
                yield waiting.pop(ready), EpisodeRecord.model_validate_json(ray.get(ready))
        finally:
            for task in waiting:
                ray.cancel(task)

    return run


def _text_of(work: Work, job: Job) -> str:
    """A record as text, which any version of any library on both sides can carry."""
    return work(job).model_dump_json()


def _connected() -> Any:
    try:
        import ray
    except ModuleNotFoundError as error:
        raise MachineError(f"ray is not installed; run: {install_part('cluster')}, or say --backend local") from error
    if not ray.is_initialized():
        ray.init(log_to_driver=False)
    return ray
