"""The skeleton-prior model: a two-person motion on other bodies, by three VAEs."""
