"""Report of an import of motion-capture files: tables and sentences."""
