"""From a joint path to the fastest trajectory within every limit: TOPP-RA profile, then an interior point method."""
