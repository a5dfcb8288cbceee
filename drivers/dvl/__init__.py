"""Codecs of Doppler velocity logs."""
