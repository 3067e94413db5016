"""Arrays filled element by element: a slice would be copied through memory of its own, and takes long to compile."""

import numpy as np

from testbed.engines.compiled import inner


@inner
def copy(source, target):
    """Fill the array `target` with `source`, both of one dimension."""
    for place in range(source.shape[0]):
        target[place] = source[place]


@inner
def fill(target, first, value):
    """Fill the array `target`, of one dimension, with a number from place `first` on."""
    for place in range(first, target.shape[0]):
        target[place] = value


@inner
def fill_columns(target, first, value):
    """Fill every row of `target` with a number from column `first` on."""
    for row in range(target.shape[0]):
        for place in range(first, target.shape[1]):
            target[row, place] = value


@inner
def fill_rows(target, first, value):
    """Fill `target`, of two dimensions, with a number from row `first` on."""
    for row in range(first, target.shape[0]):
        for place in range(target.shape[1]):
            target[row, place] = value


@inner
def end_record(out, pass_times, pass_states, position, passes):
    """NaN behind the `position` samples and the `passes` ends of tooth passes that there are."""
    fill_columns(out, position, np.nan)
    end_passes(pass_times, pass_states, passes)


@inner
def end_passes(pass_times, pass_states, passes):
    """`end_record` of the passes alone."""
    fill(pass_times, passes, np.nan)
    fill_rows(pass_states, passes, np.nan)
