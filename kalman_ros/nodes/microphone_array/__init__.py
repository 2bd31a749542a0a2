# SPDX-License-Identifier: Apache-2.0
"""The microphone array: sound in, the bearing of its source out."""
