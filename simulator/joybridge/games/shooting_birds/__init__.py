"""Shooting Birds: a crosshair, ten birds, and trees and barns in the way."""
