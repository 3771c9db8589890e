"""Which trained models are current: the gate, the history of decisions, the shelf of models."""
