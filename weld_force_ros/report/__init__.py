"""Pictures and pages of welds: figures, one self-contained page, the live page, PDF (extra: report)."""
