"""Estimators: a model is stated, a fit follows."""
