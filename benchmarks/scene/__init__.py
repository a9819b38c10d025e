"""What benchmarks are made of: scenes, rivals and rules. None of it runs by itself."""
