"""Arrays filled element by element: a slice would be copied through memory of its own, and takes long to compile."""

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
