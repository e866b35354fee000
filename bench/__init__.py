"""Measures the library on the soft-shadow workload, beside Embree where that is installed."""
