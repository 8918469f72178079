"""A small game as somebody writes it who has never heard of this project: catch what falls, by mouse or keys."""

import random
import sys

import pygame

WIDTH, HEIGHT = 320, 240


class Fruit:
    def __init__(self):
        self.x, self.y = random.randrange(WIDTH), -10
        self.speed = random.randint(2, 5)


def main():
    pygame.init()
    screen = pygame.display.set_mode((WIDTH, HEIGHT))
    clock = pygame.time.Clock()
    font = pygame.font.SysFont("arial", 20)
    tone = pygame.mixer.Sound(buffer=bytes(4410))
    x, score, lives = WIDTH // 2, 0, 20
    fruits = {Fruit()}
    while lives > 0:
        for event in pygame.event.get():
            if event.type == pygame.QUIT or (event.type == pygame.KEYDOWN and event.key == pygame.K_ESCAPE):
                pygame.quit()
                sys.exit()
            if event.type == pygame.MOUSEMOTION:
                x = event.pos[0]
            if event.type == pygame.MOUSEBUTTONDOWN and event.button == 1:
                fruits.add(Fruit())
        held = pygame.key.get_pressed()
        x += 6 * (held[pygame.K_RIGHT] - held[pygame.K_LEFT])
        if random.random() < 0.05:
            fruits.add(Fruit())
        for fruit in list(fruits):  # in the order of their hashes
            fruit.y += fruit.speed
            fruit.x += random.choice((-1, 0, 1))
            if fruit.y > HEIGHT - 20 and abs(fruit.x - x) < 25:
                fruits.remove(fruit)
                score += 10
                tone.play()
            elif fruit.y > HEIGHT:
                fruits.remove(fruit)
                lives -= 1
        screen.fill((20, 20, 40))
        for fruit in fruits:
            pygame.draw.circle(screen, (255, 120, 0), (fruit.x, fruit.y), 8)
        pygame.draw.rect(screen, (200, 200, 200), (x - 25, HEIGHT - 15, 50, 10))
        screen.blit(font.render(f"Score: {score}", True, (255, 255, 255)), (5, 5))
        pygame.display.flip()
        clock.tick(50)


if __name__ == "__main__":
    main()
