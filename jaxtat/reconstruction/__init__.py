"""The problem as one thing, and what solves it: plans, pipeline, stacks of frames."""

from .direct import Reconstruction, reconstruct, solve
from .laddered import OnLadder, on_ladder, solve_on_ladder
from .operator import ForwardOperator, circular_means, forward_operator, operator_on
from .plan import PAPER_K, ReconstructionPlan, build_plan
from .setup import Setup
from .stack import reconstruct_stack

__all__ = [
    "PAPER_K",
    "ForwardOperator",
    "OnLadder",
    "Reconstruction",
    "ReconstructionPlan",
    "Setup",
    "build_plan",
    "circular_means",
    "forward_operator",
    "on_ladder",
    "operator_on",
    "reconstruct",
    "reconstruct_stack",
    "solve",
    "solve_on_ladder",
]
