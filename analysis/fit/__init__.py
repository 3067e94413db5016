"""The simulated machine fitted to whole waveforms with every nuisance: entries, exits, speeds, angles, offsets, drifts."""
