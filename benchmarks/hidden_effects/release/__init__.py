"""A frozen release of the benchmark for other methods: datasets, sealed truths, a scorer and a data card."""
