"""System identification: regressors, non-negative least squares, hysteresis operators."""
