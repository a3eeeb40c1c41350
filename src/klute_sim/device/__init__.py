"""The musculo-tendon unit: laws plus states, an implicit step, a ledger, and the file that describes it."""
