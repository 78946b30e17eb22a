"""Sweeps: albedos over grids of parameters, angles and settings, in a Zarr store, on one machine or a cluster."""

from brdfcheck.messages import SweepError as SweepError
from brdfcheck.sweep.config import Config as Config
from brdfcheck.sweep.config import parse as parse
from brdfcheck.sweep.config import read_config as read_config
from brdfcheck.sweep.plan import Plan as Plan
from brdfcheck.sweep.runner import Estimate as Estimate
from brdfcheck.sweep.runner import Progress as Progress
from brdfcheck.sweep.runner import Summary as Summary
from brdfcheck.sweep.runner import estimate as estimate
from brdfcheck.sweep.runner import fill as fill
from brdfcheck.sweep.runner import run_sweep as run_sweep
