"""The page: tables, players and figures of one experiment."""
