"""Steps of work: stages, sweeps, workers, folders."""
