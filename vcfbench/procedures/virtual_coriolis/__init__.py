"""The virtual Coriolis calibration, the paper's four steps: settings, plan, match, results, budget, report."""
