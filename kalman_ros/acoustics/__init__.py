# SPDX-License-Identifier: Apache-2.0
"""The direction of a source of sound, from several microphones."""
