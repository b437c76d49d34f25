"""Other ways to find out what a model lacks, beside turnscope on the same experiments; see __main__.py."""
