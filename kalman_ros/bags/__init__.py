# SPDX-License-Identifier: Apache-2.0
"""Recordings in and out, and their replay without middleware."""
