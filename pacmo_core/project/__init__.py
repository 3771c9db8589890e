"""The workspace of a project: experiments, the writer lock, run records, promotion, status."""
