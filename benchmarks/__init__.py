"""Speed beside what people use otherwise: `python -m benchmarks`. Method: docs/benchmarks.md."""
