"""Gap benchmark."""
