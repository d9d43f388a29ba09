"""Scoreboard of the gap workflow: one search on each set of real measurements, in one table.

sets       sets given by their folders, and known public sets with what is published about them
study      search of every set, resumable, and the table: named and expected effects, held-out mismatch
"""
