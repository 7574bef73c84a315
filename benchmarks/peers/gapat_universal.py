"""GAPAT on the processor: the universal back-projection."""

from gapat_sum import reconstruct
from peer import run

if __name__ == "__main__":
    run("gapat", lambda problem: reconstruct(problem, "ubp"))
