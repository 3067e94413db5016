"""Data sets in HDF5: written, sealed, read and verified."""
