"""Safety limits and residuals, the independent trajectory checks, certificates. May import `robot` and `trajectory`."""
