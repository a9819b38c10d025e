"""What tests and benchmarks share; nothing here is imported by the package."""
