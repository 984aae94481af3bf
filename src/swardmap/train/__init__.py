"""Training the networks: data, augmentation, the loop, distillation, export. torch lives only here."""
