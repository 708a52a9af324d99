"""Design of a layout: seeds, figures of merit, the optimiser and a second opinion on what it returns."""
