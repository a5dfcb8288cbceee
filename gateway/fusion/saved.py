"""The filter as a message, and back: what outlives its process."""

import numpy as np

from gateway.fusion.memory import Memory
from gateway.fusion.state import State
from gateway.messages import SavedState


def saved(memory: Memory, t_ns: int) -> SavedState:
    """The filter's memory at a time."""
    return SavedState(
        t_ns=t_ns,
        x=memory.state.x.tobytes(),
        P=memory.state.P.tobytes(),
        columns=memory.state.columns.tobytes(),
        used=memory.used,
        gated=memory.gated,
        refused_in_a_row=memory.refused_in_a_row,
        t_used_ns=memory.t_used_ns,
        quality=memory.quality.copy(),
        noise=memory.noise.copy(),
        aided=memory.aided,
        velocity_refused=memory.velocity_refused.copy(),
    )


def state_of(message: SavedState) -> State:
    """Mean and covariance."""
    # A copy of each: for arrays that may not be written to, functions are compiled anew.
    columns = np.frombuffer(message.columns, dtype=np.int64).copy()
    P = np.frombuffer(message.P).reshape(len(columns), len(columns)).copy()
    return State(np.frombuffer(message.x).copy(), P, columns)


def memory_of(message: SavedState) -> Memory:
    """The filter's memory."""
    return Memory(
        state_of(message),
        message.used,
        message.gated,
        message.refused_in_a_row,
        message.t_used_ns,
        quality=message.quality.copy(),
        noise=message.noise.copy(),
        velocity_refused=message.velocity_refused.copy(),
        aided=message.aided,
    )
