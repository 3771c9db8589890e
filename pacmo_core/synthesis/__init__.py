"""The embedded default: two-person captures whose law of reaction is known."""
