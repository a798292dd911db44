"""Figures and pages of welds: one self-contained page, the live page, PDF (extra: report)."""
