"""Normalisation factors and compact formulas for albedos: minimax fits with certificates."""
