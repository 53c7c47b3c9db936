"""What a ribbon must do to be trusted, a file a topic. Installed as ribbonhil.checks."""
