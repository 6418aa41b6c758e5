"""First contact with a capture: what it is, and a job for it that renders well as it stands."""

from __future__ import annotations

from mirelight.apps.first_job.job_text import FirstJob, Wish, job_for

__all__ = ["FirstJob", "Wish", "job_for"]
