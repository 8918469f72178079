"""Recall: a small game that nobody can play without memory."""
