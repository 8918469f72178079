"""Shooting Birds: shoot birds with a crosshair; trees and barns hide some of them."""
