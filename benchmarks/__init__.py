"""Speed beside filterpy, statsmodels, `solve_banded`, pyarrow and a bare Zenoh put: ratios in one run."""
